"""Figures and tables of Liland (2018), reproduced and judged."""
