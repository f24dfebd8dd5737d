"""Maps looked at as a whole: two of them against each other, and branches that hang together."""
