"""Motion made from published kinematics, without recordings."""
