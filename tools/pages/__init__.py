"""What pages have that follows from the code: tables and pictures."""
