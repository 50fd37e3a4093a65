"""Gymnasium environments over jshape. Empty for now: the environments are built on the finished library."""
