"""The control law of one axis: compensator, identifier, trim."""
