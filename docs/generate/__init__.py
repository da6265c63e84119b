"""Pages and pictures that are made from the package, so that they cannot fall behind it."""
