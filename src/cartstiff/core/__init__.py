"""What is true at a posture: energies, mechanisms, the reduction, equilibria."""
