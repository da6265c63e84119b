"""A campaign played through on vehicles drawn from its priors."""
