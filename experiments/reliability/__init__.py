"""How reliable jshape is: figures, each computed by one command."""
