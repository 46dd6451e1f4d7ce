"""Numbers, units, paragraphs and snippets as text."""
