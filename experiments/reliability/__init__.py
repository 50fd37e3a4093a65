"""How the project behaves under damaged files, faulty disks and arbitrary input: figures and what computes them."""
