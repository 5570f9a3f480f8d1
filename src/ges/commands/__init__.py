"""Commands of ``ges``, one module each, which offers ``command``, a click command."""
