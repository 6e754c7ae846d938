"""What one device tells about another."""
