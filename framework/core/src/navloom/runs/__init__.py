"""What a run is: episode, recorder, trail, measures, and the files that it leaves."""
