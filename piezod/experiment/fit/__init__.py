"""Identification: from a recorded drive and displacement to an inverse model."""
