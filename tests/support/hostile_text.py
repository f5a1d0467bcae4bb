"""Text that tries to break out of wherever a report puts it."""

#: Everything at once that breaks out of text, attributes, style sheets, scripts, comments or templates.
HOSTILE = (
    '"\' onmouseover=pwned() x="><pwned></style></script></svg></title><script>pwned()</script>'
    "<img src=x onerror=pwned>{{7*7}}{% raw %}<!-- ]]> &lt;pwned&gt; $\\frac{1}$ \u202e\x00\U0001f69a javascript:pwned"
)
