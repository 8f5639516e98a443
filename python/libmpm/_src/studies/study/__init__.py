"""Studies: one scene a row of a table, run on whatever takes work, and one table at the end."""
