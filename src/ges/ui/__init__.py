"""A local web page to drop flight logs on: what ``ges ui`` serves."""
