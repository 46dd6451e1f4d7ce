"""Limits of what is read from files and of what is listed in text.

Files may come from anyone: each reader checks the size before it reads, and the number of rows before it
allocates. A list in a sentence, table or figure ends after a few entries and says how many follow.
"""

from __future__ import annotations

import math

# Descriptions: TOML, YAML, JSON, URDF, calibration files of robots. The largest seen has 0.4 MB.
MAX_DESCRIPTION_BYTES = 20_000_000
# Tables, arrays and results: a million poses with their covariances.
MAX_TABLE_BYTES = 1_000_000_000
# A message, or the metadata of a recording, that becomes objects: Python needs up to a hundred times the memory of the
# encoded numbers, and a YAML parser of its text. Usual ones have some ten thousand.
MAX_MESSAGE_BYTES = 1_000_000
# Beginning of a file by which its format is recognised.
HEAD_BYTES = 65_536
# A file that is uploaded in the live page.
MAX_UPLOAD_BYTES = 50_000_000
# Files that a pattern names.
MAX_FILES = 100_000
# Rows of a table, messages of a topic, samples of a stream.
MAX_ROWS = 10_000_000
# Characters of a line, of a name, and of a part of a file that a message quotes.
MAX_LINE_CHARACTERS = 10_000
MAX_NAME_CHARACTERS = 200
# Lengths (m) of a cell without a unit; larger ones are in another unit, as millimetres.
MAX_PLAIN_LENGTH_M = 10.0
# Angles (rad) of a cell without a unit; larger ones are in degrees.
MAX_PLAIN_ANGLE_RAD = 2.0 * math.pi + 1e-3
# Seconds to wait for another program: what writes a pipe or holds a lock, a cluster, a browser.
MAX_WAIT_S = 120
# Entries that a sentence names before "and n more", and rows that a printed table has.
MAX_NAMED = 6
MAX_LISTED = 12
# Rows of a table of poses, pictures or points, and of a list of topics; of more, the worst or the first.
MAX_PRINTED_ROWS = 40
# Correlations of two components are listed from this size on.
MIN_SHOWN_CORRELATION = 0.5
# Points that a figure draws; more are thinned evenly.
MAX_DRAWN_POINTS = 4_000
# Poses that decide between two readings of a file, as units, directions or orders.
MIN_POSES_TO_DECIDE = 4
# Poses that determine X at least: two motions about different axes.
MIN_POSES = 3
# Poses, motions, views or points from which on outliers can be distinguished from the others.
MIN_POSES_FOR_ROBUST = 5
# Share of the poses that is relied on, by their smallest residuals: all others may be wrong.
MAJORITY = 0.6
# Residuals beyond this many times the median are no chance: Gaussian noise reaches it in 3 of 1000 poses.
OUTLIER_MEDIANS = 6.0
# Share of chi-square, or of squared residuals, that another reading of the files may leave to explain them.
MAX_LEFT_SHARE = 0.01
# Standard deviation of a focal length, relative, above which distances are too uncertain.
MAX_FOCAL_SD_SHARE = 0.01
# Without a tolerance a check must show a shift of this share of the distance of the target, and this rotation (rad).
VISIBLE_CHANGE = 0.01
