"""`python -m service.manual` builds the site of the manual. It needs the extra `docs` of the package."""

import sys

from service.manual.build import BuildError, build

if __name__ == "__main__":
    try:
        build()
    except BuildError as error:
        sys.exit(str(error))
