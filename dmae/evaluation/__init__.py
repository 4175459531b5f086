"""Where does it break: methods scored over clips and camera subsets."""
