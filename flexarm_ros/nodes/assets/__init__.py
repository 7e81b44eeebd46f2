"""Layouts for the programs that show a run live."""
