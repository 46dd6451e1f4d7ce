"""The certificate of a calibration: its budget, coverage, conditions and traceability."""
