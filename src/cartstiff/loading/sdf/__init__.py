"""SDF files, as Gazebo keeps robots; read by rod."""
