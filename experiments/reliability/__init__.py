"""The reliability of jshape: figures, each computed by one command."""
