"""The HTTP service of a daemon: endpoints, roles, lease, limits and answers."""
