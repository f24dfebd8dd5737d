"""Springs from measurements, and which measurements to make."""
