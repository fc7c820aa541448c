"""Protocols without I/O: bytes and frames in, bytes and frames out. Host and device roles are apart and share only tables of constants."""
