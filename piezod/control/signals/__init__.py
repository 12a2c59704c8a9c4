"""Small statistics over the last samples; pure, with fixed memory."""
