"""HOW IS A DATA SET MADE IN PARTS? Which clips a part holds, and how parts become one data set."""
