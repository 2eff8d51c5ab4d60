"""How long tests wait for what must come. On no machine, however busy, is a test to need it."""

LIMIT = 300.0
"""After this time pytest ends a test [s]."""

GUARD = 200.0
"""After this time a test gives up by itself, and says what it has waited for [s]."""
