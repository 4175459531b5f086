"""HOW DO JOINTS MOVE TOGETHER? A Gaussian process with a learned kernel for each joint of a limb."""
