"""IPaBD mapping for navloom: a pitched laser's 3D image pressed to a 2D map (Hoang et al. 2013)."""
