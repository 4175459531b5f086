"""WHERE DO CAMERAS GO? Places for cameras in a room, chosen by what they would capture of simulated people."""
