"""Files from outside: how large each kind may be, and how each is read without building more than that."""
