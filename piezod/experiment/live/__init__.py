"""An experiment or identification on a running stage, through the client."""
