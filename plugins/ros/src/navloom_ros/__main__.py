"""`python -m navloom_ros`."""

from navloom_ros.cli import main

main()
