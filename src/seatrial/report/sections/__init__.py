"""Sections of the page: each module turns an outcome into what the template of the same name prints."""
