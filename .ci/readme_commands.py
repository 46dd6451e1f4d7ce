"""Print the README's two ```sh blocks, each ended by a NUL: the scripts that .ci/run runs in its own clone.

They start in the folder of the README.
"""

import re
import sys
from pathlib import Path

text = Path(sys.argv[1]).read_text(encoding="utf-8")
for block in re.findall(r"^```sh\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)[:2]:
    print(block.rstrip("\n"), end="\0")
