"""How right it is: studies that are run for hours, and fill the tables of pages."""
