"""A session of calibration: poses that arrive one by one, the estimate after each, and the page in a browser."""
