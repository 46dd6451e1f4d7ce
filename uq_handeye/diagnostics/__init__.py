"""What residuals and geometry say about a fit."""
