"""From a picture to tracked bearings (II-IV, IX-A), in reading order.

image -> edges -> ring -> lines -> faults -> descriptor -> matching -> tracker. `frontend.FrontEnd` is the one step
Frame -> Bearings; its `stages` are the same step in parts, for whoever times them. `account.Account` sums up for people
what the bearings say of pictures, ring and mirror.
"""
