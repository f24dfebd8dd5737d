"""Small vibrations about a rest state: modes under load, response, damping."""
