"""How right it is: lines and identities judged against a truth, the same way whoever found them."""
