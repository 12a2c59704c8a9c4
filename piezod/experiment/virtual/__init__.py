"""An experiment in virtual time, on devices that this process owns."""
