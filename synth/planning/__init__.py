"""Plan where to mount cameras in a room. The places are chosen for the capture of simulated people."""
