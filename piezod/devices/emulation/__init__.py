"""What emulators of devices share: the physics behind the connector, and the far end of a wire."""
