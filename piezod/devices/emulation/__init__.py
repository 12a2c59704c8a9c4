"""Common parts of device emulators: the physics behind the connector, the device end of a wire."""
