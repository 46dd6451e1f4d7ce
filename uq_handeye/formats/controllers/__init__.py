"""Poses as the controllers of robots and people write them: tables, records, and the programs of the makers."""
