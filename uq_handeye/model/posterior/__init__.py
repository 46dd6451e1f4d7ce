"""The joint posterior of the unknown poses and of every error, which check, update, plan and predict use."""
