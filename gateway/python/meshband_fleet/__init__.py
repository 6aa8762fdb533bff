"""Many meshband nodes at once: queries on the Parquet history, a fleet page, and jobs over many records.

Nothing is computed here that the `meshband` command or the nodes compute: queries select and average, jobs call the command.
"""
