"""Labels of simulated clips: visibility of joints and surface points in each camera, their occluders, and the forces
that support people."""
