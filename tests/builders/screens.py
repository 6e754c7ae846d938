"""A terminal, as which a program's output and input are shown and typed."""

import io


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True
