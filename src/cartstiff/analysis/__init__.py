"""What a stiffness matrix says: ellipsoids, centres, screws, indices, equilibrium."""
