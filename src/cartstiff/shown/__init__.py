"""Words, figures, report, scene, page and commands: what shows answers."""
