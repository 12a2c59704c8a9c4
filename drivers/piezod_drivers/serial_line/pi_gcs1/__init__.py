"""PI controllers of the first General Command Set: E-816 in E-621, E-625, E-665, and E-516."""
