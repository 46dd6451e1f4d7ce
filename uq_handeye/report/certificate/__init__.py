"""The certificate of a calibration: measurand, result, GUM budget, conditions, traceability and decision."""
