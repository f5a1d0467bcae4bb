"""How well `init` guesses: campaigns in several formats and with other names, against what their files say."""
