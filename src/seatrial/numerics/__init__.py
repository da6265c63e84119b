"""Mathematics without vehicles: small triangular algebra, sigma points, one-step integrators."""
