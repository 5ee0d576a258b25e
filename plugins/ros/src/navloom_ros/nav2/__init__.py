"""Sends goals to a robot that Nav2 drives, with the interface of `navloom.Navigator`."""
