// Two quadrature encoders on an Arduino, sent as encoder-protocol.md says: $T,<us>,<left>,<right>*<CRC-16>
//
// Channel A of each encoder on a pin that can interrupt (Uno: 2 and 3), channel B on any other.
// One count for each edge of channel A: encoder.ticks_per_rev = 2 x lines x gear.

const unsigned char LEFT_A = 2, LEFT_B = 4, RIGHT_A = 3, RIGHT_B = 5;
const unsigned long BAUD = 115200;        // encoder.baud
const unsigned long PERIOD_US = 20000;    // 50 lines a second

volatile long leftCount = 0, rightCount = 0;
unsigned long lastUs = 0;

void leftEdge() { leftCount += digitalRead(LEFT_A) == digitalRead(LEFT_B) ? 1 : -1; }
void rightEdge() { rightCount += digitalRead(RIGHT_A) == digitalRead(RIGHT_B) ? 1 : -1; }

// CRC-16/CCITT-FALSE
unsigned int crc16(const char *text) {
  unsigned long crc = 0xFFFF;
  for (; *text; ++text) {
    crc ^= (unsigned long)(unsigned char)*text << 8;
    for (unsigned char bit = 0; bit < 8; ++bit) {
      crc = crc & 0x8000 ? (crc << 1) ^ 0x1021 : crc << 1;
      crc &= 0xFFFF;
    }
  }
  return (unsigned int)crc;
}

void setup() {
  Serial.begin(BAUD);
  pinMode(LEFT_A, INPUT_PULLUP);
  pinMode(LEFT_B, INPUT_PULLUP);
  pinMode(RIGHT_A, INPUT_PULLUP);
  pinMode(RIGHT_B, INPUT_PULLUP);
  attachInterrupt(digitalPinToInterrupt(LEFT_A), leftEdge, CHANGE);
  attachInterrupt(digitalPinToInterrupt(RIGHT_A), rightEdge, CHANGE);
}

void loop() {
  if ((unsigned long)(micros() - lastUs) < PERIOD_US) return;
  lastUs += PERIOD_US;

  // Both counts and the time belong to one moment.
  noInterrupts();
  unsigned long now = micros();
  long left = leftCount, right = rightCount;
  interrupts();

  char body[48], line[64];
  snprintf(body, sizeof body, "T,%lu,%ld,%ld", now, left, right);
  snprintf(line, sizeof line, "$%s*%04X\n", body, crc16(body));
  Serial.print(line);
}
