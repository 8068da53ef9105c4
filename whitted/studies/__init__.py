"""Studies: a matrix of renders into a database, to be stopped, continued, merged and read at any time."""
