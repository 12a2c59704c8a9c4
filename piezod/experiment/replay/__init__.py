"""A recording again in virtual time: with the model that was used, or with another one."""
