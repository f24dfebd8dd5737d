"""Properties of a stiffness matrix: ellipsoids, centres, screws, indices, tolerances."""
