"""Commands that use a model without a stage."""
