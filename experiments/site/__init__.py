"""The documentation: pages, and ``python -m experiments.site``, which builds them."""
