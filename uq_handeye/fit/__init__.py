"""Joint model of poses and errors, fitted; what residuals and geometry say."""
