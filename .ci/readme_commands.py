"""Print the README's two ```sh blocks, each ended by a NUL: the scripts that .ci/run runs in its own clone.

Lines that clone the project and enter its folder are left out, as the clone is there.
"""

import re
import sys
from pathlib import Path

text = Path(sys.argv[1]).read_text(encoding="utf-8")
for block in re.findall(r"^```sh\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)[:2]:
    lines = (line for line in block.splitlines() if not line.startswith(("git clone ", "cd ")))
    print("\n".join(lines), end="\0")
