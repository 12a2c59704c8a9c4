"""What a configuration may say, and the loader that tells file, line and column where it does not.

Knows nothing of the other rooms; a driver brings the model of its own options.
"""
