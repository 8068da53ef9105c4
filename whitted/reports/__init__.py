"""Pages that show a study: one HTML file each, which needs no network."""
