"""The commands, by what they are about; nothing heavy is imported before a command runs."""
