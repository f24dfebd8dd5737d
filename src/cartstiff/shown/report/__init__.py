"""Results for people and programs: text, JSON schema, files, figures."""
