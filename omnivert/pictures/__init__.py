"""What a person looks at: pictures by matplotlib, and the words and roundings that terminal and picture share."""
