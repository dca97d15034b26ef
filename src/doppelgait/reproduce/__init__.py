"""The figures and tables of Liland (2018), made again and judged; the command ``doppelgait reproduce``."""
