"""What an experiment needs of its stage: virtual, running, or driven by hand."""
