"""What the report page is made of: a template, its style and its script."""
