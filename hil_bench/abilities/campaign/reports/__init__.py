"""Reports of campaigns and searches: one HTML file each, which opens without a network."""
