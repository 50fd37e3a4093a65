"""Shapers that change while they run, without a jump in the command."""
