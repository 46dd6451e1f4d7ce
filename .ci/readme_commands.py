"""Print the commands of the README's first ```sh blocks, one per line: what .ci/run runs word for word."""

import re
import sys
from pathlib import Path

text = Path(sys.argv[1]).read_text(encoding="utf-8")
for block in re.findall(r"^```sh\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)[:2]:
    print(block.strip())
