"""What a cycle over a bus costs, beside the bare minimum on the same bytes."""
