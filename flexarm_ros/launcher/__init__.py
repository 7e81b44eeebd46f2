"""Starting, watching and ending the processes of a run, and suites of runs."""
