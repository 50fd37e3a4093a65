"""Papers, benchmarks and studies that use jshape as anyone would."""
