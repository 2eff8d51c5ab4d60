"""What a run leaves behind: channels, frames and their files."""
