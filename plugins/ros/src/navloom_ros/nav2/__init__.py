"""A robot that Nav2 drives, from Python, as `navloom.Navigator` is one that navloom drives."""
