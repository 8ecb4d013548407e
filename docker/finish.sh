#!/bin/sh
# Prepares a virtual environment for an image: finish.sh FOLDER
set -eu
site=$(echo "$1"/lib/python3.*/site-packages)

# Files that are not needed at run time.
find "$site" -type d -name tests -prune -exec rm -rf {} +
find "$site" \( -name '*.pyx' -o -name '*.pxd' -o -name '*.h' -o -name '*.a' \) -type f -delete

# Bytecode is valid if its source's time is the same; image layers do not store fractions of a second.
find "$1" -name '*.py' -exec touch --date=2020-01-01 {} +
"$1"/bin/python -m compileall -q "$site" >/dev/null || true # some packages contain templates of source code
