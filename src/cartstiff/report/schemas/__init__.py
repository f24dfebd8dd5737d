"""The forms of the JSON output, as JSON Schemas."""
