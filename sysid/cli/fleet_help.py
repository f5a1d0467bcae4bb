"""The help of `fleet`, apart from its commands: the help of all commands is shown without loading them."""

FLEET_HELP = """Many campaigns side by side, and what they say together.

'fleet FLEET' is short for 'fleet run FLEET'; FLEET is a fleet.toml or a folder of campaigns.

Exit codes of 'fleet run': 0 every campaign has converged or is a preview, 2 bad command or fleet file, 3 a campaign
was rejected, failed or crashed, or the folder cannot be written, 4 one has not converged, 130 stopped by Ctrl-C.
One failure never stops the others.
"""
