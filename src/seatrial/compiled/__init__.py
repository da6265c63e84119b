"""JAX's machinery: settings, programs kept between runs, lanes, random keys. Nothing else imports a private module of JAX."""
