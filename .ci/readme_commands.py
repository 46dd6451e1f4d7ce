"""Print the README's two ```sh blocks, each ended by a NUL: the commands that .ci/run runs in a clone each."""

import re
import sys
from pathlib import Path

text = Path(sys.argv[1]).read_text(encoding="utf-8")
for block in re.findall(r"^```sh\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)[:2]:
    print(block.rstrip("\n"), end="\0")
