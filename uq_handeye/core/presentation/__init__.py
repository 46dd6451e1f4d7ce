"""The toolkit of pages: blocks, figures, notebook, PDF, ellipses, placed labels."""
