"""One file an algorithm, one folder a task; the file's name is the name in the configuration."""
