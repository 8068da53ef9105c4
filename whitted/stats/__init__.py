"""Statistics on NumPy arrays; nothing here knows of Mitsuba or Dr.Jit."""
