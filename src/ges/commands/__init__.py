"""One module a verb; each offers ``command``, a click command."""
