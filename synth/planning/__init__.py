"""WHERE SHOULD CAMERAS BE MOUNTED? Places for cameras in a room, chosen by the capture of simulated people."""
